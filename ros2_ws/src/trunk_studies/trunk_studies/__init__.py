"""Many runs: compiled batches, sweeps over any parameter, comparisons, maps; tuning; the paper's figures."""
