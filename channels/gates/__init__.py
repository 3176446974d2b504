"""The rules of the radio medium, one a module. `channels.medium` puts them in order."""
