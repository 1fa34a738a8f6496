"""Where and how a fitted model fails: noise floor, residual scores, whiteness, maps of the residual."""
