"""Many scans: jobs from a file, each in a process and a run folder of its own; none is done twice.

Why it is made like this: docs/adr/0021-batch.md.
"""
