"""The plants that come with the simulator."""
