"""Synthetic buildings drawn as plans are: pictures in several styles, and walls a little off."""
