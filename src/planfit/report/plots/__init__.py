"""Pictures: the scan on the plan, and what a run measured, as PNG."""
