"""What a sample scatters beside its surface, one unit each: BRDF, hemispherical part, source."""
