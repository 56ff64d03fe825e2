"""A campaign: experiments on an unknown joint, each chosen from those before."""
