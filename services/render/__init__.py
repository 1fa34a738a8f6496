"""Rendering for people: every sentence, table, plot, report and page of HTML."""
