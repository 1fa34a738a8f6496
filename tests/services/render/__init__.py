"""Sentences, tables and plots."""
