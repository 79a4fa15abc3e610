"""Many runs, with the compiled closed loop."""
