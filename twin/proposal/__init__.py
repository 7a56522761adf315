"""A first `campaign.toml` for unknown files: channels, units, signs and kinds of recordings as the data show them."""
