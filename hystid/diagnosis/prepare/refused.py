"""The reason why recordings or a structure cannot be diagnosed: a verdict, and no error of the user."""

SHORTEST = 200  # samples: below this nothing can be told from noise


class NotDiagnosable(Exception):
    """Why there can be no diagnosis, as one sentence."""
