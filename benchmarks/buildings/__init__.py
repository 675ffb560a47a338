"""Every real scan and plan that is at hand, with drifts drawn afresh: what planfit makes of each building.

python benchmarks/buildings run -o buildings.jsonl      (--help tells the rest)
"""
