/* Absolute deadlines on CLOCK_MONOTONIC: sleeps to SPIN before each and spins the rest, as the loop's clock does.
   clock PERIOD_NS COUNT PRIORITY SPIN_NS: the lateness of each wake-up in us, a line each. */
#define _GNU_SOURCE
#include <fcntl.h>
#include <sched.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <time.h>
#include <unistd.h>

static long long now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec * 1000000000LL + t.tv_nsec;
}

int main(int argc, char **argv)
{
    if (argc != 5)
        return 2;
    long long period = atoll(argv[1]), spin = atoll(argv[4]);
    int count = atoi(argv[2]), awake = open("/dev/cpu_dma_latency", O_WRONLY), zero = 0;
    struct sched_param priority = {.sched_priority = atoi(argv[3])};
    double *late = calloc(count, sizeof *late);
    mlockall(MCL_CURRENT | MCL_FUTURE);
    prctl(PR_SET_TIMERSLACK, 1);
    if (awake >= 0 && write(awake, &zero, sizeof zero) < 0)
        close(awake);
    sched_setscheduler(0, SCHED_FIFO, &priority);
    long long deadline = now();
    for (int i = 0; i < count; i++) {
        deadline += period;
        long long until = deadline - spin;
        struct timespec t = {until / 1000000000LL, until % 1000000000LL};
        clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &t, NULL);
        long long woke;
        while ((woke = now()) < deadline)
            ;
        late[i] = (woke - deadline) / 1e3;
    }
    for (int i = 0; i < count; i++)
        printf("%.3f\n", late[i]);
    return 0;
}
