"""What goes to other tools and comes from other methods."""
