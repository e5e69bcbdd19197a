"""The baseline and the candidate effects on a measured motion.

In: Modelica classes or FMUs, and segments. Out: forces along the motion, and which parameters are linear.
"""
