"""Joint least squares over baseline, corrections of the chain, and effects.

In: a problem and a start. Out: fits with residual, covariance and robust errors.
"""
