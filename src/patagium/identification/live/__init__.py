"""A learner beside a robot in flight."""
