"""Physics plus network: a law in Modelica with its parameters, and small networks for the force that it leaves."""

from hystid.identification.hybrid.fit import combine
from hystid.identification.hybrid.law import Law, law_of
from hystid.identification.hybrid.result import Hybrid, Pair

__all__ = ["Hybrid", "Law", "Pair", "combine", "law_of"]
