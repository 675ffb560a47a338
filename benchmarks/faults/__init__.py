"""A battery of faulty scans and plans: what planfit makes of them, and what it says of it.

python benchmarks/faults run -o faults.jsonl      (--help tells the rest)
"""
