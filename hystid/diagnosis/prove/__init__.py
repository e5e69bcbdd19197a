"""What was decided, shown on free runs and on recordings that were held out.

In: an answer. Out: the extended model, its free runs, and contradictions.
"""
