// What the drivers share: one request a line in on stdin, followed by the measurements as doubles;
// one answer a line out. The other end is ransac_fix/audit/worker/native.py.
//
//   request  ENTRY MAX_TRIALS CONFIDENCE SEED THRESHOLD ROWS COLUMNS, then ROWS * COLUMNS doubles;
//            MAX_TRIALS is -1 for a run at the library's defaults
//   answer   TRIALS MASK, with a 1 for each inlier and a 0 for each other row, or - for no model;
//            or: error WHAT
#pragma once

#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <exception>
#include <functional>
#include <map>
#include <stdexcept>
#include <string>
#include <unistd.h>
#include <vector>

namespace driver {

struct Request {
    long max_trials = -1;
    double confidence = 0;
    unsigned seed = 0;
    double threshold = 0;
    std::size_t rows = 0, columns = 0;
    std::vector<double> data;

    bool at_defaults() const { return max_trials < 0; }
    const double* row(std::size_t index) const { return data.data() + index * columns; }
};

struct Answer {
    long trials = 0;
    bool found = false;
    std::vector<int> inliers;
};

using Run = std::function<Answer(const Request&)>;

inline bool read_request(std::string& entry, Request& request) {
    char line[512], name[256], confidence[64], threshold[64];
    if (!std::fgets(line, sizeof line, stdin)) return false;
    if (std::sscanf(line, "%255s %ld %63s %u %63s %zu %zu", name, &request.max_trials, confidence,
                    &request.seed, threshold, &request.rows, &request.columns) != 7)
        return false;
    entry = name;
    request.confidence = std::strtod(confidence, nullptr);
    request.threshold = std::strtod(threshold, nullptr);
    request.data.resize(request.rows * request.columns);
    return std::fread(request.data.data(), sizeof(double), request.data.size(), stdin) ==
           request.data.size();
}

inline std::string written(const Answer& answer, std::size_t rows) {
    std::string mask = "-";
    if (answer.found) {
        mask.assign(rows, '0');
        for (int index : answer.inliers) mask.at(index) = '1';
    }
    return std::to_string(answer.trials) + " " + mask;
}

// Answer requests until there are no more.
inline int serve(const std::map<std::string, Run>& entries) {
    // Libraries print. Answers keep the real standard output, everything else goes to stderr.
    std::FILE* answers = fdopen(dup(1), "w");
    dup2(2, 1);
    std::fputs("ready\n", answers);
    std::fflush(answers);
    std::string entry;
    Request request;
    while (read_request(entry, request)) {
        std::string answer;
        try {
            answer = written(entries.at(entry)(request), request.rows);
        } catch (const std::exception& error) {
            answer = std::string("error ") + error.what();
        }
        for (char& letter : answer)
            if (letter == '\n') letter = ' ';
        std::fprintf(answers, "%s\n", answer.c_str());
        std::fflush(answers);
    }
    return 0;
}

}  // namespace driver
