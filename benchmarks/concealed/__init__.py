"""Blind benchmark of concealed physics: a rig with its own laws, sealed truths, and a score.

Nothing here is used by ``hystid.diagnosis``, and the generator uses nothing of ``hystid.diagnosis`` or of the Modelica
library: only the C compiler look-up (``hystid.toolchain``) is shared.
"""
