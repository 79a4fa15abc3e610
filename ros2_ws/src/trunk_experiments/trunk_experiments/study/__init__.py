"""Studies: grids and draws over any parameter; sweeps, comparisons, maps."""
