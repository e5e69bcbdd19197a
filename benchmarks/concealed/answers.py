"""What counts as a right answer: exact equivalents, families, and the expectation of each group of cases."""

from __future__ import annotations

# The same recordings up to a refit of the baseline: algebra, not statistics.
EQUIVALENT = (
    frozenset({"two_sided_stop", "backlash"}),  # free play = stop minus a linear spring
    frozenset({"added_mass", "force_gain"}),  # both scale F against m a; all force parameters follow
)

# Names that ordinary recordings can hardly part; a name from the same family counts for "class right".
FAMILIES = (
    frozenset({"preload", "asymmetric_friction", "force_drift"}),
    frozenset({"cubic_stiffness", "two_sided_stop", "backlash"}),
    frozenset({"quadratic_stiffness", "bilinear_stiffness", "contact_loss", "impact"}),
    frozenset(
        {
            "coulomb_friction",
            "stribeck_friction",
            "asymmetric_friction",
            "position_dependent_friction",
            "hysteretic_friction",
        }
    ),
    frozenset({"quadratic_damping", "displacement_dependent_damping"}),
    frozenset({"viscoelastic_relaxation", "hidden_mode"}),
    frozenset({"cyclic_degradation", "stiffness_drift"}),
    frozenset({"added_mass", "force_gain"}),
)

# One effect that is exactly two of the catalogue: naming both is right as well.
SUMS = {
    "asymmetric_friction": frozenset({"coulomb_friction", "preload"}),
    "stribeck_friction": frozenset({"stribeck_friction"}),
}


def same_name(answer: str, truth: str) -> bool:
    """Whether the answer is the truth or an exact equivalent of it."""
    return answer == truth or any({answer, truth} <= group for group in EQUIVALENT)


def same_family(answer: str, truth: str) -> bool:
    """Whether answer and truth are of one family."""
    return same_name(answer, truth) or any({answer, truth} <= group for group in FAMILIES)
