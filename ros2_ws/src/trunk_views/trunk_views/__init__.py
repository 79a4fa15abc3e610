"""What people look at: plots, films, reports, comparisons, markers; a running graph in a browser."""
