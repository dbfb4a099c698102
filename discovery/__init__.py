"""Decides between models: candidate tension laws, residual tracing, the closed loop."""
