"""Forces of the air on the body: drag, lift, side force."""
