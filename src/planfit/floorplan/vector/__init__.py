"""From line work to walls."""
