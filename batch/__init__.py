"""Many runs: what is to be run, workers, results, and what follows from them."""
