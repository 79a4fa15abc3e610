/* Times the exported law and the one by hand, alternately; prints ns an update of both, a line a round. */
#include "law.h"

#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#include "by_hand.c"

enum { SAMPLES = 1024, REPEATS = 200 };

static double now_ns(void) {
    struct timespec t;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return 1e9 * (double)t.tv_sec + (double)t.tv_nsec;
}

int main(int argc, char **argv) {
    static LAW_SAMPLE samples[SAMPLES];
    static LAW_CONTROLLER c;
    static LAW_TERMS terms;
    static Hand m;
    static HandTerms hand;
    const int rounds = argc > 1 ? atoi(argv[1]) : 7;
    uint64_t state = 1963;
#ifdef FUZZY
    static double gains[4] = {32.0, 60.0, 9.6, 18.0};
#else
    static double gains[3] = {60.0, 100.0, 9.0};
#endif
    static HandLimits limits = {2, 1, 0.0, -100.0, 100.0, -1e300, 1e300, 0.0};
    for (int i = 0; i < SAMPLES; i++) {
        state = state * UINT64_C(6364136223846793005) + 1442695040888963407u;
        samples[i].reference = 0.1;
        samples[i].measurement = (double)(int64_t)(state >> 40) * 0x1p-24 - 0.5;
        samples[i].rate = (double)(int64_t)((state >> 16) & 0xffffff) * 0x1p-22 - 2.0;
        samples[i].dt = 0.005;
        samples[i].hip.position = samples[i].hip.velocity = 0.0;
    }
    LAW_RESET(&c);
    for (int i = 0; i < SAMPLES; i++) { /* the same law? */
        const LAW_SAMPLE *s = &samples[i];
        LAW_UPDATE(&c, s, &terms);
        hand_update(&m, &hand, s->reference, s->measurement, s->rate, s->dt, gains, &limits);
        if (hand.effort != terms.effort || hand.alpha != terms.alpha) {
            return 1;
        }
    }
    for (int round = 0; round < rounds; round++) {
        volatile double sum = 0.0;
        double begun = now_ns();
        for (int k = 0; k < REPEATS; k++) {
            for (int i = 0; i < SAMPLES; i++) {
                LAW_UPDATE(&c, &samples[i], &terms);
                sum = sum + terms.effort;
            }
        }
        const double ours = now_ns() - begun;
        begun = now_ns();
        for (int k = 0; k < REPEATS; k++) {
            for (int i = 0; i < SAMPLES; i++) {
                const LAW_SAMPLE *s = &samples[i];
                hand_update(&m, &hand, s->reference, s->measurement, s->rate, s->dt, gains, &limits);
                sum = sum + hand.effort;
            }
        }
        printf("%.3f %.3f\n", ours / (REPEATS * SAMPLES), (now_ns() - begun) / (REPEATS * SAMPLES));
    }
    return 0;
}
