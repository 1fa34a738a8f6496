"""What lacet computes on fixed inputs, stored: a change that only moves or renames leaves every digit as it was."""
