// Runs PCL's sample consensus methods. Rows hold a point, two where clouds are registered.
//
// Without rows the answer is the default cap on iterations in place of a count of trials. Seeds and
// counts of trials are protected members, reached as a subclass would.
#include "driver.hpp"

#include <algorithm>
#include <memory>

#include <pcl/ModelCoefficients.h>
#include <pcl/console/print.h>
#include <pcl/point_types.h>
#include <pcl/sample_consensus/lmeds.h>
#include <pcl/sample_consensus/mlesac.h>
#include <pcl/sample_consensus/msac.h>
#include <pcl/sample_consensus/prosac.h>
#include <pcl/sample_consensus/ransac.h>
#include <pcl/sample_consensus/rmsac.h>
#include <pcl/sample_consensus/rransac.h>
#include <pcl/sample_consensus/sac_model_circle.h>
#include <pcl/sample_consensus/sac_model_line.h>
#include <pcl/sample_consensus/sac_model_plane.h>
#include <pcl/sample_consensus/sac_model_registration.h>
#include <pcl/sample_consensus/sac_model_sphere.h>
#include <pcl/segmentation/sac_segmentation.h>

namespace {

using driver::Answer;
using driver::Request;
using Point = pcl::PointXYZ;
using Cloud = pcl::PointCloud<Point>;
using Model = pcl::SampleConsensusModel<Point>;
using Method = pcl::SampleConsensus<Point>;

struct ModelMembers : Model {
    static void seed(Model& model, unsigned value) { (model.*(&ModelMembers::rng_alg_)).seed(value); }
};

struct MethodMembers : Method {
    static int trials(const Method& method) { return method.*(&MethodMembers::iterations_); }
};

Cloud::Ptr cloud(const Request& request, int which = 0) {
    auto points = pcl::make_shared<Cloud>();
    for (std::size_t i = 0; i < request.rows; ++i) {
        const double* from = request.row(i) + 3 * which;
        points->push_back(Point(static_cast<float>(from[0]), static_cast<float>(from[1]),
                                static_cast<float>(from[2])));
    }
    return points;
}

// A budget of T runs T + 1 trials, and one of 0 none, or one: one trial is that of confidence 0.
template <class Settable>
void limit(Settable& settable, const Request& request) {
    if (request.at_defaults()) return;
    settable.setMaxIterations(static_cast<int>(std::max(1L, request.max_trials - 1)));
    settable.setProbability(request.max_trials == 1 ? 0.0 : request.confidence);
}

template <class Chosen>
struct Configured : Chosen {
    using Chosen::Chosen;

    void prepare(const Request&) {}
};

// These try a part of the points first, and count the samples that it rejects.
template <>
struct Configured<pcl::RandomizedRandomSampleConsensus<Point>>
    : pcl::RandomizedRandomSampleConsensus<Point> {
    using pcl::RandomizedRandomSampleConsensus<Point>::RandomizedRandomSampleConsensus;

    void prepare(const Request& request) {
        if (!request.at_defaults()) setFractionNrPretest(0);
    }
};

template <>
struct Configured<pcl::RandomizedMEstimatorSampleConsensus<Point>>
    : pcl::RandomizedMEstimatorSampleConsensus<Point> {
    using pcl::RandomizedMEstimatorSampleConsensus<Point>::RandomizedMEstimatorSampleConsensus;

    void prepare(const Request& request) {
        if (!request.at_defaults()) setFractionNrPretest(0);
    }
};

// Inliers lie within two deviations, each the threshold times the spread of the points.
template <>
struct Configured<pcl::MaximumLikelihoodSampleConsensus<Point>>
    : pcl::MaximumLikelihoodSampleConsensus<Point> {
    using pcl::MaximumLikelihoodSampleConsensus<Point>::MaximumLikelihoodSampleConsensus;

    void prepare(const Request& request) {
        const double spread = computeMedianAbsoluteDeviation(sac_model_->getInputCloud(),
                                                             sac_model_->getIndices(), 1.0);
        setDistanceThreshold(request.threshold / (2 * spread));
    }
};

// The budget is the number of trials here.
template <>
struct Configured<pcl::LeastMedianSquares<Point>> : pcl::LeastMedianSquares<Point> {
    using pcl::LeastMedianSquares<Point>::LeastMedianSquares;

    void prepare(const Request& request) {
        if (!request.at_defaults()) setMaxIterations(static_cast<int>(request.max_trials));
    }
};

template <template <class> class Chosen>
Answer solve(const Model::Ptr& model, const Request& request) {
    ModelMembers::seed(*model, request.seed);
    Configured<Chosen<Point>> method(model);
    Answer answer;
    if (request.rows == 0) {
        answer.trials = method.getMaxIterations();
        return answer;
    }
    method.setDistanceThreshold(request.threshold);
    limit(method, request);
    method.prepare(request);
    answer.found = method.computeModel(0);
    answer.trials = MethodMembers::trials(method);
    method.getInliers(answer.inliers);
    return answer;
}

template <template <class> class Chosen, class ChosenModel>
Answer fit(const Request& request) {
    return solve<Chosen>(pcl::make_shared<ChosenModel>(cloud(request)), request);
}

Answer register_clouds(const Request& request) {
    auto model = pcl::make_shared<pcl::SampleConsensusModelRegistration<Point>>(cloud(request));
    model->setInputTarget(cloud(request, 1));
    return solve<pcl::RandomSampleConsensus>(model, request);
}

struct Segmentation : pcl::SACSegmentation<Point> {
    unsigned seed = 0;

    bool initSACModel(const int model_type) override {
        const bool done = pcl::SACSegmentation<Point>::initSACModel(model_type);
        if (done) ModelMembers::seed(*model_, seed);
        return done;
    }
};

Answer segment(const Request& request) {
    Segmentation segmentation;
    Answer answer;
    if (request.rows == 0) {
        answer.trials = segmentation.getMaxIterations();
        return answer;
    }
    segmentation.seed = request.seed;
    segmentation.setModelType(pcl::SACMODEL_PLANE);
    segmentation.setMethodType(pcl::SAC_RANSAC);
    segmentation.setDistanceThreshold(request.threshold);
    limit(segmentation, request);
    segmentation.setInputCloud(cloud(request));
    pcl::PointIndices inliers;
    pcl::ModelCoefficients coefficients;
    segmentation.segment(inliers, coefficients);
    answer.found = !coefficients.values.empty();
    answer.trials = MethodMembers::trials(*segmentation.getMethod());
    answer.inliers = inliers.indices;
    return answer;
}

}  // namespace

int main() {
    using namespace pcl;
    using Plane = SampleConsensusModelPlane<Point>;
    console::setVerbosityLevel(console::L_ALWAYS);
    return driver::serve({
        {"ransac.plane", fit<RandomSampleConsensus, Plane>},
        {"ransac.line", fit<RandomSampleConsensus, SampleConsensusModelLine<Point>>},
        {"ransac.circle", fit<RandomSampleConsensus, SampleConsensusModelCircle2D<Point>>},
        {"ransac.sphere", fit<RandomSampleConsensus, SampleConsensusModelSphere<Point>>},
        {"ransac.registration", register_clouds},
        {"msac.plane", fit<MEstimatorSampleConsensus, Plane>},
        {"mlesac.plane", fit<MaximumLikelihoodSampleConsensus, Plane>},
        {"rransac.plane", fit<RandomizedRandomSampleConsensus, Plane>},
        {"rmsac.plane", fit<RandomizedMEstimatorSampleConsensus, Plane>},
        {"prosac.plane", fit<ProgressiveSampleConsensus, Plane>},
        {"lmeds.plane", fit<LeastMedianSquares, Plane>},
        {"segmentation.plane", segment},
    });
}
