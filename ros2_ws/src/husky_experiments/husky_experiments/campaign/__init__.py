"""Campaigns: many runs of an experiment, over conditions and seeds, and one table of them."""

from husky_experiments.campaign.campaign_file import CampaignError, read_campaign
from husky_experiments.campaign.engine import run

__all__ = ["CampaignError", "read_campaign", "run"]
