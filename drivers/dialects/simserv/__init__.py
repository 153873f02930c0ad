"""Weiss and Vötsch chambers by SIMSERV, the protocol of their SIMPAC controllers."""
