"""Springs, dampers, friction, bars and stops: forces in the suspension rows."""
