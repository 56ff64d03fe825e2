"""A campaign: experiments on an unknown joint that choose themselves until a goal is reached."""
