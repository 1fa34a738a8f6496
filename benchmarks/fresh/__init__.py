"""The fresh benchmark: verdicts on cars never seen before, with many effects hidden at once.

See ``docs/benchmarks/fresh.md``. `laws` what can be hidden and what it may be called; `cars`, `drives` a car, its rig
and its runs, drawn anew; `sizing` how far an effect stands out of the noise; `making` a trial from its number;
`identifying` what sees a trial's tables and nothing else; `scoring` the comparison with what was hidden; `page` counts.
`second`, `second_page`: the same on the second car (``docs/benchmarks/second-blind.md``).
"""
