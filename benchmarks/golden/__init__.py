"""Golden runs: eight short runs whose poses are kept, for a rebuilding that changes nothing to pass.

python benchmarks/golden check      (--help tells the rest)
"""
