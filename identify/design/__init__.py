"""Design of experiments: the run to drive next, for narrower intervals or to distinguish effects."""
