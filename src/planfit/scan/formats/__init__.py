"""Readers of scans, one module a format."""
