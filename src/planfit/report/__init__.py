"""What a run did, to look at: the overlay picture and the report, one self-contained HTML file."""
