"""Validation of a fitted model: noise floor, residual scores, whiteness, dependence of the residual on states."""
