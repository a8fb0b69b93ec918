"""The microfacet integrals of Equations 5 to 8: quadrature, tables and maps."""
