"""Readers of plans, one module a format."""
