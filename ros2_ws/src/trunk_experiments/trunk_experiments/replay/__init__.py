"""What was run, judged: recomputed, compared, explained, run again."""
