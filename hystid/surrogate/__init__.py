"""ONNX networks as plain C: compiled in double precision, no runtime inside, ready for the FMU shell."""

from hystid.surrogate.c99 import c_source
from hystid.surrogate.network import network_code
from hystid.surrogate.restoring_force import model_code, oscillator_code, surrogate_code

__all__ = ["c_source", "model_code", "network_code", "oscillator_code", "surrogate_code"]
