"""How pixels answer the light: transport, area lights, interreflection."""
