"""From fits to names.

In: a refit and the effects. Out: which physics is missing, and how probable that is.
"""
