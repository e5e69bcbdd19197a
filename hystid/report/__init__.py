"""Self-contained interactive HTML reports: pages made from result objects."""
