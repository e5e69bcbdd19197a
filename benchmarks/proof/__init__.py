"""A second generator of test cases for the diagnosis, for proof only.

It shares no code, no law, no integrator and no noise with the engine or with ``benchmarks/concealed``, and was written
without reading either. A seed counts as spent once its answers have been looked at.

    python -m benchmarks.proof.run --seed 1 --cases 40 -o ../proof-1
    python -m benchmarks.proof.score ../proof-1
"""
