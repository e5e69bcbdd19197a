"""Least squares by Levenberg-Marquardt: one loop for one problem or many at once, the damping rule as an argument."""

from hystid.leastsquares.marquardt import REASONS, Descent, LeastSquaresProblem, Reason, Rule, minimise

__all__ = ["REASONS", "Descent", "LeastSquaresProblem", "Reason", "Rule", "minimise"]
