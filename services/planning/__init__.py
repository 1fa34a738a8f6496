"""Planning of runs: the nominal car, the library of manoeuvres, simulated runs and what each would tell."""
