"""The method from a scan and a plan to refined poses, stage by stage."""
