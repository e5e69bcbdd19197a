"""Recordings made ready for fitting.

In: recordings. Out: segments with smoothed motion, noise levels and the raw force balance. Afterwards every channel
that counts as a measurement has a known noise level.
"""
