"""A sparse least-squares engine over SE(3) poses: terms, robust losses, solvers, covariances.

It knows nothing of scans or plans.
"""
