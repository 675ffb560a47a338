"""Clouds of mobile laser scanners with the scanner's trajectory: cut into instants, seen as depth images."""
