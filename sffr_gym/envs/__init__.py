"""The Gymnasium environments of ``SFFRFlex-v0``: single and vectorised."""
