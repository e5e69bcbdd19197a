"""Physics plus network: a law in Modelica with its parameters, and small networks for the force that it leaves."""
