"""Defects of the front end rumoca, one file each: what it does, and the text that it takes instead.

Seen in rumoca 0.10. ``tests/test_workarounds.py`` holds the smallest text that shows each defect, and fails where a new
version no longer needs the way around it. Nothing else rewrites Modelica text.
"""
