"""Modelica to C: ``compile_model`` turns a class of the library or of a file into ``ModelCode``.

The compiler is a list of passes: text -> (front end) -> ``FlatModel`` -> scalar equations -> named events -> sorted
equations (``HybridModel``) -> C. docs/modelica.md states the language subset.
"""

from hystid.modelica.compile import compile_model, flat_model

__all__ = ["compile_model", "flat_model"]
