"""The first day on a real robot, stage by stage: `trocar commission`; docs/first-hardware.md is its guide."""
