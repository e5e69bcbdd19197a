"""An answer put into words, places and files.

In: an answer and its proof. Out: the result with its headline, findings and next experiment.
"""
