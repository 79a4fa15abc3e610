"""A lab: a scenario's closed loop as WebAssembly in one HTML file that needs no server."""
