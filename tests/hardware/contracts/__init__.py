"""What every implementation of an interface must keep; each implementation's maker is listed beside the suite."""
