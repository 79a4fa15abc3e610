"""Studies: draws and grids over any parameter, swept, compared, mapped."""
