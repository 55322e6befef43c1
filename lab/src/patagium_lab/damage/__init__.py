"""Study of a wing that is lost in flight: a controller whose model of the air relearns, or not."""
