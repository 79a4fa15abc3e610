"""The messages of an edited copy, by topic."""

COMMAND, STATE, TRUTH = "/effort_command", "/joint_states", "/ground_truth/joint_states"
DISTURBANCE = "/disturbance"


def of(messages, topic):
    return [message for message in messages if message[0] == topic]


def without(part, *topics):
    """Return an edit that removes a part of each topic's messages."""

    def edit(messages):
        for topic in topics:
            for message in of(messages, topic)[part]:
                messages.remove(message)

    return edit
