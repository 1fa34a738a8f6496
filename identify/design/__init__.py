"""Design of experiments: which run to drive next, for intervals or for telling effects apart."""
