/* Runs every law on the same pseudo-random arrays and prints a hash of what it writes: one line a law. */
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "law.h"

static uint64_t state;

/* In [0.1, 1.1), now and then negative: a limit, a mass, a part of a posture. */
static double number(void) {
    state = state * 6364136223846793005u + 1442695040888963407u;
    double found = 0.1 + (double)(state >> 11) / 9007199254740992.0;
    return (state >> 5) % 16 ? found : -found;
}

int main(void) {
    const Law *laws[] = {&tool_pose,      &admittance,   &moca_impedance, &kairos_clik, &torque_guard, &velocity_guard,
                         &position_guard, &sent_tracker, &command_left,   &ur_take,      &ur_fill,
                         &felt_wrench,    &object_mapping, &panda_fill,  &panda_torque, &panda_record,   &panda_watch};
    for (size_t i = 0; i < sizeof laws / sizeof *laws; i++) {
        uint64_t hash = 1469598103934665603u;
        int done = 0;
        state = 1;
        for (int run = 0; run < 3000; run++) {
            double *arrays[32];
            int n = 1 + run % 8, count = 0, size[32];
            for (const Arg *arg = laws[i]->args; arg->name; arg++, count++) {
                size[count] = arg->fixed + arg->each * n;
                arrays[count] = malloc(size[count] * sizeof(double));
                for (int k = 0; k < size[count]; k++) arrays[count][k] = number();
            }
            if (laws[i] == &sent_tracker) memcpy(arrays[1], arrays[0], n * sizeof(double));
            if (laws[i] == &ur_take) /* what a robot sends: big-endian, from the second byte on */
                for (int k = size[0] * 8 - 1; k > 0; k--) {
                    double sent = number();
                    unsigned char *at = (unsigned char *)arrays[0];
                    at[k] = ((unsigned char *)&sent)[7 - (k - 1) % 8];
                }
            if (laws[i] == &panda_fill || laws[i] == &panda_torque || laws[i] == &panda_record)
                for (int k = 0; k < size[1]; k++) arrays[1][k] = 8 * k; /* bytes of the packet */
            if (laws[i] == &position_guard) /* joints near to where they are to go, at rest; or under way, so they are planned */
                for (int k = 0; k < n; k++) {
                    double *row = arrays[4] + 5 * k, *limits = arrays[2] + 4 * k;
                    row[0] = row[2] = arrays[0][k] *= 0.01;
                    row[1] = row[3] = row[4] = run & 2 ? 0.01 * number() : 0.0;
                    arrays[1][k] = row[1] + 1e-3 * number();
                    limits[0] = limits[1] = 1.0;
                    limits[2] = -1.0;
                    limits[3] = 1.0;
                    arrays[0][k] += (run & 2 ? 1e-2 : 1e-7) * number();
                }
            if (laws[i] == &object_mapping) { /* all fingertips, two of them as far apart as the sphere is wide, and a short finger */
                double *options = arrays[4], *reference = arrays[6], *at = arrays[7];
                for (int k = 0; k < 5; k++) options[1 + k] = k;
                options[0] = 5.0;
                options[6] = run & 2;
                options[8] = 1e-3 * fabs(options[8]);
                for (int k = 0; k < 15; k++) {
                    arrays[1][k] += k == 0 ? 9.0 : k == 3 ? -9.0 : k == 7 || k == 11 ? 6.0 : 0.0;
                    at[k] = arrays[1][k] + 1e-2 * number();
                    reference[6 + k] = at[k] + 1e-2 * number();
                }
                at[21] = 2.0;
                at[22] = 0.0;
                at[23] = 1.0;
                for (int k = 0; k < n; k++) { /* limits at which some joints are held */
                    double *row = arrays[5] + 6 * k;
                    row[2] *= 0.1;
                    row[3] = arrays[0][k] - 1e-2 * fabs(number());
                    row[5] = arrays[0][k] + 1e-2 * fabs(number());
                }
            }
            for (int cycle = 0; cycle < 3; cycle++)
                done += laws[i]->step(arrays, n, 1e-3, run & 1) != RARE;
            for (int k = 0; k < count; k++) {
                const unsigned char *bytes = (const unsigned char *)arrays[k];
                for (size_t b = 0; b < size[k] * sizeof(double); b++) hash = (hash ^ bytes[b]) * 1099511628211u;
                free(arrays[k]);
            }
        }
        printf("%s %d %016llx\n", laws[i]->name, done, (unsigned long long)hash);
    }
    return 0;
}
