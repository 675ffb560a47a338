"""Derivatives by the sensor, the odometry's and the plan's scale, held against differences."""

STEP = 1e-6


class _Planes:
    """A stand-in for a term, with groups given."""
