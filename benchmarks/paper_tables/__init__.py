"""The paper's three tables: its terms and strategies on synthetic and real scans, compared scan by scan.

python benchmarks/paper_tables paper -o paper.json      (--help tells the rest)
"""
