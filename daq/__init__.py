"""The measurement vocabulary of lacet and the ways data is stored and moved: channels, frames, blocks, runs, log, bus."""
