"""hystid: Modelica/FMI co-simulation for structures that slide, stick, open and close."""
