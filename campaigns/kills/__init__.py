"""Trials that kill workers and commands of campaigns."""
