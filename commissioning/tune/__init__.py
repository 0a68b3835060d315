"""Measure how one joint follows its goals with the gains of its servo, and propose better gains."""
