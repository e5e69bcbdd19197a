"""Identification of a restoring force with memory from recordings: the two-network method."""

from hystid.identification.entry import Method, identify
from hystid.identification.prediction import Prediction, predict
from hystid.identification.result import Comparison, Identification, LinearFit

__all__ = ["Comparison", "Identification", "LinearFit", "Method", "Prediction", "identify", "predict"]
