"""Work in a process of its own, for code that may crash, hang, leak memory, print, or end the process it runs in.

``Child.ask`` calls a function there by name. Requests and answers are JSON with arrays beside it, so that whatever
happened over there, nothing but numbers and texts comes back. A child that dies, stays silent for too long, or lives on
for ever without an answer is one ``ChildError`` with the reason; the next request starts another.
"""

from hystid.child.process import Child, ChildError
from hystid.child.serving import beat, is_child

__all__ = ["Child", "ChildError", "beat", "is_child"]
