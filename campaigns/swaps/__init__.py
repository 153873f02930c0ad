"""Instruments that exchange their ports, and second masters: nobody is told what was meant for another."""
