// Native Voro++ beside multivoro: every cell of the seeds in a file, with its volume, on so many threads.
// Each thread has a container of its own, since a container's computations share scratch memory, and takes every
// so-manieth cell. Prints the sum of the volumes, the seconds by the wall, and the seconds of processor time.
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <thread>
#include <vector>

#include <voro++/voro++.hh>

int main(int argc, char **argv) {
    if (argc != 4) return 1;
    const int n = std::atoi(argv[2]), threads = std::atoi(argv[3]);
    std::vector<double> seeds(3 * static_cast<size_t>(n));
    std::FILE *file = std::fopen(argv[1], "rb");
    if (!file || std::fread(seeds.data(), sizeof(double), seeds.size(), file) != seeds.size()) return 1;
    std::fclose(file);
    std::vector<double> sums(threads, 0.0);
    const auto start = std::chrono::steady_clock::now();
    const std::clock_t ticks = std::clock();
    auto work = [&](int part) {
        voro::pre_container guess(0, 1, 0, 1, 0, 1, false, false, false);
        for (int i = 0; i < n; i++) guess.put(i, seeds[3 * i], seeds[3 * i + 1], seeds[3 * i + 2]);
        int nx, ny, nz;
        guess.guess_optimal(nx, ny, nz);
        voro::container box(0, 1, 0, 1, 0, 1, nx, ny, nz, false, false, false, 8);
        guess.setup(box);
        voro::c_loop_all loop(box);
        voro::voronoicell_neighbor cell;
        int turn = 0;
        if (loop.start()) do {
            if (turn++ % threads == part && box.compute_cell(cell, loop)) sums[part] += cell.volume();
        } while (loop.inc());
    };
    std::vector<std::thread> others;
    for (int part = 1; part < threads; part++) others.emplace_back(work, part);
    work(0);
    for (auto &one : others) one.join();
    double total = 0.0;
    for (double sum : sums) total += sum;
    const std::chrono::duration<double> wall = std::chrono::steady_clock::now() - start;
    std::printf("%.12f %.4f %.4f\n", total, wall.count(), double(std::clock() - ticks) / CLOCKS_PER_SEC);
}
