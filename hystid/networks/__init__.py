"""Tanh networks, the two-network hysteresis model, and its training by Levenberg-Marquardt."""

from hystid.networks.network import Member, Network, TwoNetworkModel

__all__ = ["Member", "Network", "TwoNetworkModel"]
