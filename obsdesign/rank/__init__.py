"""Ranks that can be trusted: CasADi graphs evaluated instruction by instruction modulo a prime, in balls, as series."""
