"""What every package uses: array types, errors, validated models, files, stores, versions."""
