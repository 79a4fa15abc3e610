"""Many runs: the closed loop compiled."""
