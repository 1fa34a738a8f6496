"""Planning of runs: the nominal car, the library of manoeuvres, simulated runs and the information of each."""
