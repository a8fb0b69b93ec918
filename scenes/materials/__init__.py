"""What objects are made of: refractive indices, reflectances, roughness, measured tables."""
