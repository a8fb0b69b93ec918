"""Materials: refractive indices, reflectances, roughness, measured tables."""
