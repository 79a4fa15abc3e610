/* The same PD in C, over Cyclone DDS (Debian: cyclonedds-dev, cyclonedds-tools; build: make). */
#include <dds/dds.h>
#include "JointState.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>

#define TOPIC(on, name) dds_create_topic(on, &sensor_msgs_msg_dds__JointState__desc, name, NULL, NULL)
typedef sensor_msgs_msg_dds__JointState_ JointState;
static const double KP = 60.0, KD = 9.0, LIMIT = 100.0; /* N m/rad, N m s/rad, N m */

static int place_of(const JointState *message, const char *joint)
{
    for (uint32_t i = 0; i < message->name._length; ++i)
        if (strcmp(message->name._buffer[i], joint) == 0) return (int)i;
    return -1;
}

int main(void)
{
    const char *domain = getenv("ROS_DOMAIN_ID");
    dds_entity_t participant = dds_create_participant(domain ? (dds_domainid_t)atoi(domain) : 0, NULL, NULL);
    dds_qos_t *qos = dds_create_qos();
    dds_qset_reliability(qos, DDS_RELIABILITY_RELIABLE, DDS_SECS(1));
    dds_qset_history(qos, DDS_HISTORY_KEEP_LAST, 100);
    dds_entity_t commands = dds_create_writer(participant, TOPIC(participant, "rt/effort_command"), qos, NULL);
    dds_entity_t references = dds_create_reader(participant, TOPIC(participant, "rt/reference"), qos, NULL);
    dds_entity_t states = dds_create_reader(participant, TOPIC(participant, "rt/joint_states"), qos, NULL);
    dds_entity_t waitset = dds_create_waitset(participant);
    dds_waitset_attach(waitset, dds_create_readcondition(states, DDS_ANY_STATE), 0);

    double reference = 0.0, value[16] = {0}; /* rad; of the states with these stamps */
    builtin_interfaces_msg_dds__Time_ stamp[16];
    for (unsigned count = 0;;) {
        void *sample = NULL;
        dds_sample_info_t info;
        dds_waitset_wait(waitset, NULL, 0, DDS_INFINITY);
        for (; dds_take(references, &sample, &info, 1, 1) > 0; dds_return_loan(references, &sample, 1)) {
            int trunk = info.valid_data ? place_of(sample, "trunk") : -1;
            if (trunk >= 0) {
                stamp[count % 16] = ((JointState *)sample)->header.stamp;
                value[count++ % 16] = ((JointState *)sample)->position._buffer[trunk];
            }
        }
        for (; dds_take(states, &sample, &info, 1, 1) > 0; dds_return_loan(states, &sample, 1)) {
            JointState *state = sample;
            int trunk = info.valid_data ? place_of(state, "trunk") : -1;
            if (trunk < 0) continue;
            for (unsigned i = 0; i < count && i < 16; ++i)
                if (!memcmp(&stamp[i], &state->header.stamp, sizeof stamp[i])) reference = value[i];
            double torque = KP * (reference - state->position._buffer[trunk]) - KD * state->velocity._buffer[trunk];
            torque = fmax(-LIMIT, fmin(torque, LIMIT));
            char *name = "trunk";
            JointState command = {.header = {state->header.stamp, ""},
                                  .name = {1, 1, &name, false}, .effort = {1, 1, &torque, false}};
            dds_write(commands, &command);
        }
    }
}
