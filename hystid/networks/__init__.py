"""Tanh networks, the two-network hysteresis model, and its training by Levenberg-Marquardt."""

from hystid.networks.model import TwoNetworkModel
from hystid.networks.perceptron import Member, Network
from hystid.networks.ports import FurtherInput, Lag, Polyline

__all__ = ["FurtherInput", "Lag", "Member", "Network", "Polyline", "TwoNetworkModel"]
