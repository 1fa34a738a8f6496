"""The blind benchmark: is a hidden effect named, and nothing when nothing is missing? See ``docs/benchmarks/blind.md``.

`cases` what is hidden; `sizing` how large, by an oracle; `making` the tables a trial gives away; `identifying` what
sees those tables and nothing else; `scoring` the comparison with what was hidden; `page` the table.
"""
