"""What every package stands on: errors, strict models, files that are whole or absent."""
