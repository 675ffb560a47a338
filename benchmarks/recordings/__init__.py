"""A battery of recordings: are units, mounts and clocks decided rightly, and are right ones left alone?

python benchmarks/recordings run -o recordings.jsonl      (--help tells the rest)
"""
