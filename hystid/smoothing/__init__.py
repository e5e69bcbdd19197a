"""The motion behind noisy channels: one joint smoother of x, v and a, and one estimate of their noise."""
