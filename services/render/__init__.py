"""Rendering of results for people: sentences, tables, plots, reports and pages of HTML."""
